"""The paper's experiment: drive the field, find landmarks, localise, and show how well it went."""
