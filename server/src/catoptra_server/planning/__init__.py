"""What is decided before a frame is drawn. Nothing here needs a GPU; nothing on a GPU decides."""
