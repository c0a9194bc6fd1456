"""From the request for a frame to encoded bytes.

`frame_request` describes a frame that is due, `image_port_layout` composes one from the cameras of
robots, `capture_scheduler` decides when; `render_thread` renders on views of `view_cache`, by plans
of `frame_plan`; `mailbox` hands each `Frame` to the connections that wait.
"""
