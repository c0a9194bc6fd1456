"""The command `live`: a robot drives the paper's route and localizes itself, in real time.

The server's page shows the robot, and viewers may drive.
"""
