"""Process 1: Modbus and the correction, nothing else."""
