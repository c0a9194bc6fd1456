"""Values of the paper with which the studies compare their own.

Source: Schmits & Visser 2009, An Omnidirectional Camera Simulation for the USARSim World.
"""

from __future__ import annotations

# Width and height of the paper's images; every displacement in pixels refers to this size.
PAPER_SIZE_PX = 360

# Polygons of the mirror meshes in the paper's Figures 3 and 8.
PAPER_POLYGON_COUNTS = (16, 64, 256, 1024)

# The paper stops at 1024. One mesh more shows that the error goes on falling as 1/N.
POLYGON_COUNTS = (*PAPER_POLYGON_COUNTS, 4096)

# Bound of the filter's position error in both drives of Figure 13.
PAPER_EKF_ERROR_M = 0.6

# Position error that odometry alone exceeds at several steps of Figure 13.
PAPER_ODOMETRY_ERROR_M = 1.0

# Bound of the filter's position error over the whole simulated drive.
PAPER_SIM_EKF_ERROR_M = 0.5

# Mean position error of the filter on the diagonal of the simulated drive, steps 84 to 100.
PAPER_DIAGONAL_ERROR_M = 0.349

# Step of the real drive in which measurements start to pass the gate.
PAPER_RELOCK_STEP = 23
