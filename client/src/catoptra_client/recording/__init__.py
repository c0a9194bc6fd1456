"""Recordings: frames and readings of a server as an MCAP file of ROS 2 messages, without ROS."""
