"""Print a recorded drive without Catoptra: pip install mcap mcap-ros2-support.

python examples/read_recording.py drive.mcap
"""

import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for _, _, message, ros in reader.iter_decoded_messages(topics=["/ground_truth"]):
        at = ros.pose.pose.position
        print(f"{1e-9 * message.log_time:.2f} s: x {at.x:.3f} m, y {at.y:.3f} m")
