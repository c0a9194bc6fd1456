"""Charts of the experiment: detector, trajectories, errors, and an overview of all three."""
