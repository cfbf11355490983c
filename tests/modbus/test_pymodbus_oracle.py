"""pymodbus as an independent second opinion on the bytes of a frame."""

from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU

from gateway.modbus.crc import append_crc, crc16
from gateway.modbus.mbap import MbapDecoder, encode_mbap
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, encode_rtu

units = st.integers(1, 247)
pdus = st.binary(min_size=1, max_size=253)
addresses = st.integers(0, 0xFF00).map(lambda address: address.to_bytes(2, "big"))
words = st.lists(st.integers(0, 0xFFFF).map(lambda word: word.to_bytes(2, "big")), min_size=1, max_size=123)
write_pdus = st.builds(
    lambda a, w: b"\x10" + a + len(w).to_bytes(2, "big") + bytes((2 * len(w),)) + b"".join(w),
    addresses,
    words,
)
read_replies = words.map(lambda w: bytes((3, 2 * len(w))) + b"".join(w))


@given(data=st.binary(max_size=254))
def test_check_sums_agree(data: bytes) -> None:
    # pymodbus gives the two bytes in the order of the wire
    assert crc16(data).to_bytes(2, "little") == FramerRTU.compute_CRC(data).to_bytes(2, "big")
    assert FramerRTU.check_CRC(data, int.from_bytes(append_crc(data)[-2:], "big"))


@given(unit_id=units, pdu=pdus)
def test_rtu_frames_are_the_same_bytes(unit_id: int, pdu: bytes) -> None:
    assert encode_rtu(unit_id, pdu) == FramerRTU(DecodePDU(is_server=True)).encode(pdu, unit_id, 0)


@given(transaction_id=st.integers(0, 0xFFFF), unit_id=units, pdu=pdus)
def test_tcp_frames_are_the_same_bytes(transaction_id: int, unit_id: int, pdu: bytes) -> None:
    frame = FramerSocket(DecodePDU(is_server=True)).encode(pdu, unit_id, transaction_id)
    assert encode_mbap(transaction_id, unit_id, pdu) == frame
    assert MbapDecoder().feed(frame) == [(transaction_id, unit_id, pdu)]


@given(unit_id=units, pdu=write_pdus)
def test_a_write_is_cut_out_alike(unit_id: int, pdu: bytes) -> None:
    wire = encode_rtu(unit_id, pdu)
    _, their_unit_id, _, their_pdu = FramerRTU(DecodePDU(is_server=True)).decode(wire)
    assert RtuRequestDecoder().feed(wire, 0) == [(their_unit_id, their_pdu)]


@given(unit_id=units, pdu=read_replies)
def test_a_read_reply_is_cut_out_alike(unit_id: int, pdu: bytes) -> None:
    wire = encode_rtu(unit_id, pdu)
    _, their_unit_id, _, their_pdu = FramerRTU(DecodePDU(is_server=False)).decode(wire)
    decoder = RtuReplyDecoder()
    decoder.expect(unit_id, bytes((3, 0, 0, 0, pdu[1] // 2)))
    assert decoder.feed(wire, 0) == [(their_unit_id, their_pdu)]
