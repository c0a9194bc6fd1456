"""Robot classes as robot files describe them, and the motion of a base and its joints."""
