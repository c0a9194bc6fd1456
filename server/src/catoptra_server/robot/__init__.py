"""The robot's body: what it is (description) and how it moves (skid_steer)."""
