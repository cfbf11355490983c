"""Making certificates for Modbus/TCP Security, and saying what is in them."""
