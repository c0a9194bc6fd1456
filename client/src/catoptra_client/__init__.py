"""What a robot's author installs: drive, receive frames, find landmarks, localise. No OpenGL."""
