"""Configuration: from the text of ini files to frozen descriptions in SI units.

Bottom to top: `unreal_ini` is the grammar, `section_reader` typed values with located errors,
`ini_file` one file with the files it is based on. `robot_file`, `world_file`, `camera_file` and
`server_file` give the keys their meaning; the cameras of a robot's section are read by
`mirror_camera` and `robot_cameras`. `startup` reads all files of a server. Unreal units and degrees
end here.
"""
