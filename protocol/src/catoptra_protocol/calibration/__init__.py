"""Calibration files of other programs, read and written: a table of formats and conventions."""
