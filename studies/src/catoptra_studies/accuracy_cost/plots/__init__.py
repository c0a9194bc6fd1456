"""Plots of the study, one a module, each drawn on a page of `plot_style`."""
