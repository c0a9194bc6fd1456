"""What accuracy is worth to a robot: the study's key steps, driven, seen and localised by."""
