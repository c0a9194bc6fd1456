"""Configuration: from the text of ini files to frozen descriptions in SI units.

Bottom to top: `unreal_ini` is the grammar, `section_reader` typed values with located errors,
`ini_file` one file with the files it is based on. `robot_file`, `world_file` and `server_file` give
the keys their meaning; each list of a robot's section has a reader of its own (`sensor_readers`,
`perspective_camera_items`, `mission_package_items`, `joint_parts`, `omni_camera_section`). Unreal
units and degrees end here.
"""
