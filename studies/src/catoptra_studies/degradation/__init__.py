"""What degraded images do to the colour classifier and to the filter that localises by it."""
