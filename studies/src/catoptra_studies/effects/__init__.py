"""Pages of the image effects: each with and without, in scenes that need the effect or not."""
