"""The study of degraded images: colour classification and localization as images get worse.

`degradation_sweeps` is the table of all ways and levels; `degradation_study` drives robots through
server processes and compares two classifiers on the same recorded frames.
"""
