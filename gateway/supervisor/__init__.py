"""Process 2: it keeps the tables of the relay up to date. The relay needs it for nothing else."""
