"""From ini text to frozen descriptions: `unreal_ini` the grammar, `settings` typed values with good
errors, `robot_file` and `world_file` the meaning. Unreal's units end here."""
