"""Pure maths: laser readings to tables."""

import os

# Hundreds of small systems are solved for one fit: threads for each of them cost a hundred times what they
# save where another process has the cores (200 targets on two busy cores: 1.6 s with one, 100 s with two).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
