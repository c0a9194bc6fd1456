"""Bases of USARSim's robots, which robot files leave to the source of the class.

UT2004 P2AT and UDK P3AT: replies of real servers. P2DX: wheels and body from the manufacturer's
data sheet of the Pioneer 2-DX, since no reply of that class is public; the wheel speed gives the
driving speed of the P2AT. Ride heights are our choice: half the body's height.
"""

from __future__ import annotations

from dataclasses import replace

from catoptra_server.robot.robot_description import DriveBase

P2AT = DriveBase(
    wheel_radius_m=0.13,
    wheel_separation_m=0.4712,
    wheel_base_m=0.2884,
    dimensions_m=(0.5238, 0.4968, 0.2913),
    ride_height_m=0.1457,
    mass_kg=14.0,
    max_speed_rad_s=5.385,
    max_torque=60.0,
    turn_slip=0.0,
    slip_noise=0.0,
)
P2DX = replace(
    P2AT,
    wheel_radius_m=0.0955,
    wheel_separation_m=0.33,
    wheel_base_m=0.185,  # from the driven axle to the castor's
    dimensions_m=(0.44, 0.38, 0.22),
    ride_height_m=0.11,
    mass_kg=9.0,
    max_speed_rad_s=7.33,  # 0.70 m/s on these wheels, as the P2AT's 5.385 on larger ones
)
P3AT = DriveBase(
    wheel_radius_m=0.098,
    wheel_separation_m=0.36,
    wheel_base_m=0.248,
    # UDK reports wheel base, track and 0 here, which is no body to collide with.
    dimensions_m=(0.248, 0.36, 0.0),
    collision_dimensions_m=(0.508, 0.497, 0.277),  # the manufacturer's data sheet
    ride_height_m=0.1385,
    mass_kg=11.9,
    max_speed_rad_s=1.3,
    max_torque=50000.0,
    turn_slip=0.0,
    slip_noise=0.0,
)

# By the name of the class without its package, in lower case.
STANDARD_BASES = {"p2at": P2AT, "omnip2at": P2AT, "p2dx": P2DX, "omnip2dx": P2DX, "p3at": P3AT}
