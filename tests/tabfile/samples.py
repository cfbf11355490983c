"""A sound file or two of each dialect, with what they mean: what the tests of all dialects go by."""

from pathlib import Path
from typing import Final

from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, FileContext
from tests.tabfile import meanings
from tests.tabfile.mutants import Sample

TABLES: Final = Path(__file__).parents[2] / "tables"
AMC: Final = ErrorSense.ACTUAL_MINUS_COMMAND

CMA: Final = ErrorSense.COMMAND_MINUS_ACTUAL
SIEMENS_CEC: Final = b"""%_N_NC_CEC_INI
CHANDATA(1)
$AN_CEC[0,0]=0.0        ; forward
$AN_CEC[0,1]=0.003
$AN_CEC[0,2]=0.005
$AN_CEC[0,3]=0.004
$AN_CEC_INPUT_AXIS[0]=(X1)
$AN_CEC_OUTPUT_AXIS[0]=(X1)
$AN_CEC_STEP[0]=100
$AN_CEC_MIN[0]=0
$AN_CEC_MAX[0]=300
$AN_CEC_DIRECTION[0]=1
$AN_CEC_IS_MODULO[0]='H0'
$AN_CEC[1,0]=-0.015     ; backward
$AN_CEC[1,1]=-0.012
$AN_CEC[1,2]=-0.007
$AN_CEC[1,3]=-0.009
$AN_CEC_INPUT_AXIS[1]=(X1)
$AN_CEC_OUTPUT_AXIS[1]=(X1)
$AN_CEC_STEP[1]=100
$AN_CEC_MIN[1]=0
$AN_CEC_MAX[1]=300
$AN_CEC_DIRECTION[1]=-1
$AN_CEC_IS_MODULO[1]='H0'
M0
M17
"""
WEIHONG: Final = b""";unit=mm
; measured with a laser
[X]
-300.025, 0.0270, 0.0830
-200.020, 0.0250, 0.0770
-100.015, 0.0150, 0.0680
0.000, 0.0000, 0.0570
"""
CARVERA: Final = b"""X 0.000000 1.000100
X 10.000000 1.000120
X 30.000000 1.000080
X 20.000000 1.000100
X 40.000000 1.000100
"""
SIEMENS_CEC_HEAD: Final = frozenset({7, 8, 9, 10, 11, 12, 13, 18, 19, 20, 21, 22, 23, 24})
LINUXCNC_1: Final = b"""-10 0.001 -0.001
 -8 0.001 -0.001
 -6 0.002 -0.001
 -4 0.002 -0.002
 -2 0.003 -0.002
  0 0.003 -0.002
  2 0.003 -0.003
  4 0.003 -0.002
  6 0.002 -0.001
  8 0.001 -0.001
 10 0.001 0.000
"""
ISG_EVEN: Final = b"""kopf.log_achs_name      X_ACHSE   # an even grid of 20 mm
kw.ssfk.unit            1
kw.ssfk.interval        200000
kw.ssfk.kw_startpos     -400000
kw.ssfk.kw_nr_max       4
kw.ssfk.bilateral       1
kw.ssfk.table[0].pos    30
kw.ssfk.table[1].pos    10
kw.ssfk.table[2].pos    0
kw.ssfk.table[3].pos    -25
kw.ssfk.table[0].neg    60
kw.ssfk.table[1].neg    45
kw.ssfk.table[2].neg    30
kw.ssfk.table[3].neg    15
"""
ISG_FREE: Final = b"""kw.ssfk.unit 1
kw.ssfk.interval 0
kw.ssfk.kw_startpos 0
kw.ssfk.kw_nr_max 3
kw.ssfk.bilateral 1
kw.ssfk.table[0].setpoint -400000
kw.ssfk.table[0].pos 30
kw.ssfk.table[0].neg 60
kw.ssfk.table[1].setpoint -200000
kw.ssfk.table[1].pos 10
kw.ssfk.table[1].neg 45
kw.ssfk.table[2].setpoint 150000
kw.ssfk.table[2].pos 0
kw.ssfk.table[2].neg 30
"""
FAGOR_8065: Final = b"""X AXIS                        ;3100
MM                            ;0
2;/LSCRWDATA/NPOINTS          ;4
2;/LSCRWDATA/BIDIR            ;1
2;/LSCRWDATA/DATA/POSITION 1                        ;-127.0000
2;/LSCRWDATA/DATA/POSITION 2                        ;0.0000
2;/LSCRWDATA/DATA/POSITION 3                        ;127.0000
2;/LSCRWDATA/DATA/POSITION 4                        ;254.0000
2;/LSCRWDATA/DATA/POSERROR 1                        ;-0.0127
2;/LSCRWDATA/DATA/POSERROR 2                        ;0.0000
2;/LSCRWDATA/DATA/POSERROR 3                        ;0.0028
2;/LSCRWDATA/DATA/POSERROR 4                        ;-0.0328
2;/LSCRWDATA/DATA/NEGERROR 1                        ;-0.0027
2;/LSCRWDATA/DATA/NEGERROR 2                        ;0.0000
2;/LSCRWDATA/DATA/NEGERROR 3                        ;0.0100
2;/LSCRWDATA/DATA/NEGERROR 4                        ;-0.0228
2;/FILTER/FILTER 1/ORDER                            ;0
"""
FAGOR_TWO_WAYS: Final = b"""P001 X-20 EX 0.001 EX 0.004
P002 X0 EX -0.001 EX 0.001
P003 X30 EX 0 EX 0.003
P004 X60 EX 0.002 EX 0.006
P005 X90 EX 0.001 EX 0.003
"""
HEIDENHAIN_WIDE: Final = b"""BEGIN AXIS_Z.COM MM\r
NR   AXISPOS       BACKLASH      X             Z\r
0    -75.0000                                  +0.0040\r
1    -25.0000                                  -0.0010\r
2    +25.0000                                  +0.0030\r
3    +75.0000                                  +0.0000\r
[END]\r
"""


def shipped(name: str) -> bytes:
    return (TABLES / name).read_bytes()


def _mm(low: float, high: float) -> FileContext:
    return FileContext(units=Units.MM, travel=(low, high))


def _told(low: float, high: float, **facts: object) -> FileContext:
    return FileContext(units=Units.MM, travel=(low, high), file_units=Units.MM, **facts)  # type: ignore[arg-type]


SAMPLES: Final = (
    Sample(
        "centroid-1",
        "CNC7X.TAB",
        shipped("centroid-v1/CNC7X.TAB"),
        FileContext(units=Units.INCH, file_counts_per_unit=64000.0, travel=(-22.7, 0.0)),
        meanings.centroid_v1,
        header=frozenset({1}),
        counts_per_unit=254_000.0,
        # -25 mm: -32/64000 inch are -127 counts; -50 mm: -38/64000 inch are -150.8
        moves=((-250_000, -250_127), (-500_000, -500_151), (-250_000, -250_127)),
    ),
    Sample(
        "centroid-2",
        "cnc10z.tab",
        shipped("centroid-v2-tb058/cnc10z.tab"),
        FileContext(units=Units.INCH, travel=(-2.6, 0.0)),
        meanings.centroid_v2,
        header=frozenset({1}),
        counts_per_unit=254_000.0,
        # -1.25 from above: 0.5 tenths, 12.7 counts; -2: 2 tenths, 50.8; -1.25 from below: 4.5 tenths, 114.3
        moves=((-317_500, -317_487), (-508_000, -507_949), (-317_500, -317_386)),
    ),
    Sample(
        "centroid-3",
        "cnc10z.tab",
        shipped("centroid-v3/cnc10z.tab"),
        FileContext(units=Units.INCH, travel=(-4.1, 0.0)),
        meanings.centroid_v3,
        counts_per_unit=254_000.0,
        # -1.25 from above: -1.85 tenths, -46.99 counts; -3: -1.7, -43.18; -1.25 from below: +1.2, +30.48
        moves=((-317_500, -317_547), (-762_000, -762_043), (-317_500, -317_470)),
    ),
    Sample(
        "csv",
        "laser-errors.csv",
        shipped("csv/laser-errors.csv"),
        _mm(0.0, 400.0),
        meanings.csv_of_errors,
        # errors of 1.5 and 2.0 µm on the way down, of -4.0 on the way up
        moves=((3_000_000, 2_999_985), (1_000_000, 999_980), (2_000_000, 2_000_040)),
    ),
    Sample(
        "csv",
        "x.csv",
        shipped("csv/x.csv"),
        _mm(-400.0, 0.0),
        meanings.csv_of_corrections,
        label="csv-with-sums",
        # corrections of 3.0 µm at -250 and -0.5 at -400 on the way down, of 9.0 at -250 on the way up
        moves=((-2_500_000, -2_499_970), (-4_000_000, -4_000_005), (-2_500_000, -2_499_910)),
    ),
    Sample(
        "fanuc-csv",
        "x.csv",
        shipped("fanuc/x.csv"),
        _told(-400.0, 450.0, file_counts_per_unit=1000.0),
        meanings.fanuc,
        header=frozenset({3, 4, 5, 6, 7}),
        sums=True,
        # 3, 4 and 3 pulses of 1 µm, each 10 counts of the drive
        moves=((1_000_000, 1_000_030), (-2_500_000, -2_499_960), (-2_250_000, -2_249_970)),
    ),
    Sample(
        "mitsubishi-csv",
        "x.csv",
        shipped("mitsubishi/x.csv"),
        _told(-200.0, 200.0, file_counts_per_unit=1000.0),
        meanings.mitsubishi,
        header=frozenset({2, 3, 4, 5, 6}),
        sums=True,
        # below: 4 half units at -100, 10 at -200, so 7 between; above: -6 at 100
        moves=((-1_000_000, -999_980), (-1_500_000, -1_499_965), (1_000_000, 999_970)),
    ),
    Sample(
        "linuxcnc-0",
        "screwcompX.dat",
        shipped("linuxcnc/screwcompX.dat").replace(b" -4.2 ", b" -4.002 "),
        _told(-10.0, 10.0, format="linuxcnc-0"),
        meanings.linuxcnc_0,
        counts_per_unit=100_000.0,
        # -6 instead of -5.999, -8 instead of -7.999; on the way up -6 instead of -6.002
        moves=((-600_000, -600_100), (-800_000, -800_100), (-600_000, -599_800)),
    ),
    Sample(
        "linuxcnc-1",
        "trims.dat",
        LINUXCNC_1,
        _told(-10.0, 10.0, format="linuxcnc-1"),
        meanings.linuxcnc_1,
        counts_per_unit=100_000.0,
        moves=((-600_000, -600_100), (-800_000, -800_100), (-600_000, -599_800)),
    ),
    Sample(
        "isg",
        "achskw1.lis",
        ISG_EVEN,
        _mm(-40.0, 20.0),
        meanings.isg,
        header=frozenset({2, 3, 4, 5, 6}),
        counts_per_unit=100_000.0,
        # errors of 45 and 60 times 0.1 µm on the way down, of 10 on the way up: each 10 counts
        moves=((-2_000_000, -2_000_450), (-4_000_000, -4_000_600), (-2_000_000, -2_000_100)),
    ),
    Sample(
        "isg",
        "achskw2.lis",
        ISG_FREE,
        _mm(-40.0, 15.0),
        meanings.isg,
        label="isg-with-setpoints",
        header=frozenset({1, 2, 3, 4, 5}),
        line_of_place={6: 7, 9: 10, 12: 13},
        counts_per_unit=100_000.0,
        moves=((-2_000_000, -2_000_450), (-4_000_000, -4_000_600), (-2_000_000, -2_000_100)),
    ),
    Sample(
        "fagor-8055",
        "ML1",
        shipped("fagor-8055/ML1"),
        _told(-20.0, 160.0, error_sense=AMC),
        meanings.fagor,
        # errors of 0.001 at 90 and -0.002 at 130, so -0.0005 half way
        moves=((900_000, 899_990), (1_100_000, 1_100_005), (1_300_000, 1_300_020)),
    ),
    Sample(
        "fagor-8055",
        "table.txt",
        FAGOR_TWO_WAYS,
        _told(-20.0, 90.0, error_sense=AMC),
        meanings.fagor,
        label="fagor-8055-two-ways",
        # errors of 6 and 3 µm on the way down, of 2 on the way up
        moves=((600_000, 599_940), (300_000, 299_970), (600_000, 599_980)),
    ),
    Sample(
        "fagor-8065",
        "X.mp",
        FAGOR_8065,
        FileContext(units=Units.MM, travel=(-127.0, 254.0), error_sense=AMC),
        meanings.fagor_8065,
        header=frozenset({1, 2, 3, 4}),
        line_of_place={5: 9, 6: 10, 7: 11, 8: 12},
        # backward half way from 0 to 0.0100 the error is 0.0050, forward from 0.0028 to -0.0328 -0.0150
        moves=((635_000, 634_950), (1_905_000, 1_905_150), (1_270_000, 1_269_900)),
    ),
    Sample(
        "aerotech-cal",
        "x.cal",
        shipped("aerotech/x.cal").replace(b"; points: 13\n", b""),  # as another program writes it
        _told(-300.0, 0.0, file_start=-300.0),
        meanings.aerotech,
        header=frozenset({3, 4}),
        # the seventh and the second value: -4.6 and -1.2 µm
        moves=((-1_500_000, -1_500_046), (-2_750_000, -2_750_012), (-1_500_000, -1_500_046)),
    ),
    Sample(
        "renishaw-ren",
        "x.ren",
        shipped("renishaw/x.ren"),
        _told(-400.0, 0.0, file_counts_per_unit=1000.0),
        meanings.renishaw_ren,
        header=frozenset({1, 2, 3}),
        # 1.9 and 3.6 µm on the way down, 7.1 on the way up
        moves=((-1_000_000, -999_981), (-2_000_000, -1_999_964), (-1_000_000, -999_929)),
    ),
    Sample(
        "mint",
        "leadscrew.mnt",
        shipped("mint/leadscrew.mnt"),
        _told(0.0, 50.0),
        meanings.mint,
        header=frozenset({4, 5}),
        counts_per_unit=100_000.0,
        # down: 10 / 1.001 = 9.990010 and 2.5 / 1.001 = 2.497502; up: 10 / 1.002 = 9.980040
        moves=((1_000_000, 999_001), (250_000, 249_750), (1_000_000, 998_004)),
    ),
    Sample(
        "heidenhain-com",
        "Z_PITCH.COM",
        shipped("heidenhain-com/Z_PITCH.COM"),
        FileContext(units=Units.MM, travel=(-200.0, 600.0), error_sense=AMC),
        meanings.heidenhain,
        header=frozenset({1, 2}),
        # errors of 1.2 and 3.0 µm on the way down, of -2.1 on the way up
        moves=((1_000_000, 999_988), (0, -30), (1_000_000, 1_000_021)),
    ),
    Sample(
        "heidenhain-com",
        "AXIS_Z.COM",
        HEIDENHAIN_WIDE,
        FileContext(units=Units.MM, travel=(-75.0, 75.0), error_sense=AMC),
        meanings.heidenhain_wide,
        label="heidenhain-com-blanks",
        header=frozenset({1, 2}),
        # errors of 3 and -1 µm, the same in both directions
        moves=((250_000, 249_970), (-250_000, -249_990), (250_000, 249_970)),
    ),
    Sample(
        "siemens-eec",
        "_N_AX_EEC_INI.ini",
        shipped("siemens/_N_AX_EEC_INI.ini"),
        _told(-200.0, -196.0),
        meanings.siemens,
        header=frozenset({8, 9, 10, 11}),
        counts_per_unit=100_000.0,
        # errors of 6 and 10 µm, the same in both directions
        moves=((-19_700_000, -19_700_600), (-19_900_000, -19_901_000), (-19_700_000, -19_700_600)),
    ),
    Sample(
        "siemens-cec",
        "_N_NC_CEC_INI.ini",
        SIEMENS_CEC,
        _told(0.0, 300.0, error_sense=CMA),
        meanings.siemens_cec,
        header=SIEMENS_CEC_HEAD,
        # from above 7 µm are taken off at 200 and 12 at 100; on the way up 5 µm are added at 200
        moves=((2_000_000, 1_999_930), (1_000_000, 999_880), (2_000_000, 2_000_050)),
    ),
    Sample(
        "weihong",
        "axeserr.dat",
        WEIHONG,
        FileContext(units=Units.MM, travel=(-300.025, 0.0), error_sense=AMC),
        meanings.weihong,
        header=frozenset({1, 3}),
        # errors of 77 µm at -200.020 and 83 at -300.025 on the way down, of 25 on the way up
        moves=((-2_000_200, -2_000_970), (-3_000_250, -3_001_080), (-2_000_200, -2_000_450)),
    ),
    Sample(
        "carvera",
        "pitch_compensation.dat",
        CARVERA,
        _mm(0.0, 40.0),
        meanings.carvera,
        sums=True,
        # from 0 on the mm are longer by 0.11, 0.11, 0.09 and 0.09 µm each: 1.1, 2.2, 3.1 and 4.0 µm
        moves=((300_000, 300_031), (200_000, 200_022), (400_000, 400_040)),
    ),
    Sample(
        "pmac",
        "x.pmc",
        shipped("pmac/x.pmc"),
        FileContext(units=Units.MM, travel=(-300.0, 500.0), file_counts_per_unit=1000.0, error_sense=CMA),
        meanings.pmac,
        header=frozenset({5}),
        free_lines=True,
        # 72/16 counts are 4.5 µm; -24/16 are -1.5; half way from -32/16 to 0 -1.0
        moves=((3_000_000, 3_000_045), (-2_000_000, -2_000_015), (-500_000, -500_010)),
    ),
)
