"""Mathematics of the effects: kernels, noise, lens and mirror geometry; no keys, no criteria."""
