"""From ini text to frozen descriptions. Unreal's units end here.

`unreal_ini` is the grammar, `settings` typed values with good errors, `ini_file` a whole file;
`robot_file`, with `omni_camera`, and `world_file` are the meaning.
"""
