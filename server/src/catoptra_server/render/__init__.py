"""Two renderers behind one interface: `trace` (Embree), `raster` (OpenGL); they execute plans."""
