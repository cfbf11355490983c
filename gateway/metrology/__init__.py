"""From laser readings to tables: calculation only."""

import os

# One fit solves hundreds of small systems. When another process uses the cores, a thread for each system
# costs a hundred times what it saves (200 targets on two busy cores: 1.6 s with one, 100 s with two).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
