"""Client library of robot programs: drive, receive frames, detect landmarks, localize."""
