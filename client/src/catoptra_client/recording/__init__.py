"""Recordings: a server's frames and readings as an MCAP file of ROS 2 messages, without ROS.

`ros_messages` has the conventions of ROS, `recording_file` the file, `recorder` the stream.
"""
