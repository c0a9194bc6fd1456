"""What accuracy costs in time: steps from coarse to exact, each measured, told and pictured."""
