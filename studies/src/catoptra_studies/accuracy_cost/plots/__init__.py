"""The pictures of the study, one a file; each is drawn through the figures' one style."""
