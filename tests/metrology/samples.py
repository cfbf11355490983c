"""Readings that several tests use."""

TB058_MANUAL = """\
# axis: z
DRO (inch),Measured (inch)
-2.5,-2.5000
-2.0,-2.0001
-1.5,-1.5002
-1.0,-1.0003
-0.5,-0.5004
0.0,-0.0005
-0.5,-0.4997
-1.0,-0.9998
-1.5,-1.4999
-2.0,-2.0000
-2.5,-2.5001
"""
"""TB058's example for the Z axis: its laser, zeroed at -2.5, read 2.5 more."""

TB058_SIMULATED = (
    "DRO position\tMeasured position\tForward Error Correction (* 0.0001 inches)\n"
    "0.5\t0.4995\t5\n1\t0.9997\t3\n1.5\t1.4999\t4\n2\t2.0001\t-1\n2.5\t2.5003\t-3\n3\t3.0004\t-4\n"
    "3.5\t3.50007\t-0.7\n"
)
"""TB058's "simulated recording", as printed."""

RTL = "\r\n".join(
    [
        "HEADER::",
        "File type: LINEAR",
        "",
        "TARGET DATA::",
        "Filetype: LINEAR",
        "Target-count: 6",
        "Targets :",
        "  0.0000  20.0000  40.0000  60.0000  80.0000",
        "  100.0000",
        "Flags: 0 0 2 0",
        "",
        "USER-TEXT::",
        "Machine: mill",
        "Serial No: 4711",
        "Axis: X",
        "",
        "RUNS::",
        "Run-count: 2",
        "",
        "DEVIATIONS::",
        "Run Target Data:",
        *(f"  1   {t}   {d}" for t, d in zip(range(1, 7), (0.0, 1.5, 3.0, 2.0, -1.0, -4.5), strict=True)),
        *(f"  2   {t}   {d}" for t, d in zip(range(6, 0, -1), (-2.5, 1.0, 4.0, 5.0, 3.5, 2.0), strict=True)),
        "",
        "ENVIRONMENT::",
        "Air temp: 20.1",
        "EOF::",
        "",
    ]
)

POS = "\r\n".join(
    [
        "API X-D Laser Measurement Linear Data Table (Company Name: )",
        "File Version:\t5",
        "Instrument(S/N):\t1234",
        "TestDate: \t03/02/2020",
        "MachID: 7\tMachName: old mill\tOperator: \tFeedRate: None",
        "AxesLoc: \t(Y) 0\t(Z) 0",
        "TestAxis: \t(X)",
        "",
        "Unit:\tinch\t0",
        "IniPos:\t0",
        "EndPos:\t15",
        "Length: 15\tIncrem: 5\tRunNum: 1\tNumofPos: 4",
        "NumofPoints:\t8",
        "TestType: Bidirection\tTestMode: Auto\tDwell: 3\tWindow: 0.1",
        "Direction: 1\tHumidity: 50\tExpCoef: 6.5\tDeadPath: 0",
        "",
        "    Position\t      LasRead\t  LinearError\tStatus\tAirTemp\tAirPress\tMatTemp\tMatTemp2\tMatTemp3",
        *(
            f"  {x:.5f}\t  {-(x + error):.6f}\t  {error:.6f}\t 0\t70.00\t29.90\t77.00\t-1.00\t-1.00"
            for x, error in (
                (0, 0.000020),
                (5, 0.000100),
                (10, 0.000250),
                (15, 0.000200),
                (15, -0.000300),
                (10, -0.000250),
                (5, -0.000400),
                (0, -0.000480),
            )
        ),
        "DecimalPoints:\t4",
        "HardwareNo:\t4",
        "",
        "Comments:\tNone",
        "API Linear Error Compensation Table",
        "",
    ]
)
"""The laser counts down while the axis counts up, as it does in files in public."""

POS_MEANS = """\
API Linear Error Compensation Table
Position   \tUnidirectional Avg Error
 5.000000        0.000000
 0.000000\t 0.000033
-5.000000\t-0.000178
-10.000000       0.0

API Linear Standard Deviation Error Table
Position   \tMean
"""
