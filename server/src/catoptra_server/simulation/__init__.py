"""The simulated world in motion: `loop` owns clock and thread, `fleet` the robots.

Other threads post `events` and touch nothing else here.
"""
