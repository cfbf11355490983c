"""Sans-IO: the only place where compensation meets Modbus."""
