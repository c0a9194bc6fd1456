"""Client library of robot programs: drive, receive frames, detect landmarks, localize."""

from catoptra_client.frame_pictures import show

__all__ = ["show"]
