"""The experiment's pictures, one file each; `style` is the only door to matplotlib."""
