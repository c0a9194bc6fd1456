"""Data sets: pictures with ground truth by a recipe, in shards, on as many machines as one has.

A recipe (`recipe_file`) says what to draw. Sample i follows from the recipe and i alone (`sample`,
`poses`), is drawn like a served frame (`sample_renderer`) and lies in one shard, a tar file. A
shard is the unit of work: `local_workers` draws shards in processes of this machine, `ray_workers`
on any number of machines. `dataset_folder` is the result, and reads it back.
"""
