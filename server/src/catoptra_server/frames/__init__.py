"""From the request for a frame to encoded bytes.

`image_port` composes a frame from the cameras of robots, `frame` describes request and answer, and
encodes; `mailbox` says when a channel captures and holds the newest frame. `render_thread` renders
by `views`, which draw what `frame_plan` decides by the plans of `plan`; `labels` finds the ground
truth of a drawn image.
"""
