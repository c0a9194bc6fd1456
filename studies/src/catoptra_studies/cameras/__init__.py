"""Gallery of camera models, and comparison of cameras for a task."""
