"""Show a robot live in Foxglove's viewer: pip install foxglove-sdk catoptra-client.

Open the printed address in the viewer: all topics of a recording are there.

    python examples/foxglove_bridge.py [STREAM_PORT VIEWER_PORT]
"""

import sys

import foxglove

from catoptra_client.recording.recorder import MessageSink, MessageSource
from catoptra_client.recording.ros2_messages import encode_cdr, schema_text


class Viewer(MessageSink, foxglove.websocket.ServerListener):
    is_full, num_messages, channels, latched = False, 0, {}, {}

    def add_message(self, topic, type_name, message, *, log_ns, publish_ns, is_latched=False):
        if topic not in self.channels:
            name, text = type_name.replace("/", "/msg/"), schema_text(type_name).encode()
            schema = foxglove.Schema(name=name, encoding="ros2msg", data=text)
            self.channels[topic] = foxglove.Channel(topic, schema=schema, message_encoding="cdr")
        data = encode_cdr(type_name, message)
        self.channels[topic].log(data, log_time=log_ns)
        self.num_messages += 1
        if is_latched:
            self.latched[topic] = data, log_ns

    def on_subscribe(self, client, channel):  # late viewers get the calibration too
        if channel.topic in self.latched:
            data, log_ns = self.latched[channel.topic]
            self.channels[channel.topic].log(data, log_time=log_ns)


stream_port, port = map(int, sys.argv[1:] or (5005, 8765))
viewer = Viewer()
server = foxglove.start_server(port=port, server_listener=viewer, message_backlog_size=64)
print(f"ws://127.0.0.1:{server.port}", flush=True)
MessageSource(stream_port=stream_port).publish(viewer)
