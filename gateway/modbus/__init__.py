"""Sans-IO Modbus: PDU, RTU, MBAP, lengths, registers, exception codes. Bytes in, ADUs out."""
