"""Two renderers behind one interface: `trace` (rays on the CPU) and `raster` (OpenGL).

Both draw one scene by one shading model (`world/shading.py`) and execute plans that `frames/plan`
makes: nothing that runs on a GPU or in a ray kernel decides.
"""
