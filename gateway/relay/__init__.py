"""Process 1: Modbus and correction, nothing else."""
