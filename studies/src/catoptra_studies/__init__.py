"""Studies of cameras, renderers and localization: the only code that may use server and client."""
