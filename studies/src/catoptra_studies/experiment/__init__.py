"""The paper's experiment: two robots drive round a field and localize by coloured landmarks.

Servers are reached by address or started as processes, so the experiment runs against any server.
Route, drives, filters and their metrics serve the other studies as well.
"""
