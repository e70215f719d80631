"""The MCAP project's own reader, with checksums, and its decoder of ROS 2 messages by the definitions in the file."""

import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_compared import compared
from mcap_ros2.decoder import DecoderFactory

folder = Path(sys.argv[1])
with (folder / "forces.mcap").open("rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    messages = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
print(f"found: checksums fit; {compared(folder, messages)}")
