"""Sans-IO: the only package in which compensation meets Modbus."""
