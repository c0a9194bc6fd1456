"""Studies with a Catoptra server: the paper's experiment, accuracy against cost, image effects.

`experiment` and `degradation` reach their servers by address or as processes and import nothing of
catoptra_server. `accuracy_cost`, `effects` and `camera_figures` render with the server's own code.
All studies share `plot_style`, `commands`, `paper_values` and `reports`.

No other code may import the server and the client, and only accuracy against cost, effect pages,
camera figures and cameras do. The paper's experiment stays apart, so that it runs against any
server.
"""
