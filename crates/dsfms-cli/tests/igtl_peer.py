"""The other side of tests/igtl.rs: pyigtl as server, client and receiver of `dsfms track`.

    igtl_peer.py serve FRAMES       a server that sends the pictures of a folder (raw RGB, WxH in the name)
    igtl_peer.py listen HOST:PORT   a client; prints what it got as a line of JSON
    igtl_peer.py receive            a server that is sent to; likewise

A server prints its port first.
"""

import json
import os
import sys
import time
from pathlib import Path

import numpy
import pyigtl

LAST = 11
LIMIT_S = 120.0


def wait(holds):
    start = time.time()
    while not holds():
        if time.time() - start > LIMIT_S:
            sys.exit("nothing came")
        time.sleep(0.002)


def told(message):
    """What can be compared of a message."""
    out = {"type": message.message_type, "device": message.device_name, "time": repr(message.timestamp)}
    if message.message_type == "TRANSFORM":
        out["matrix"] = message.matrix.tolist()
    if message.message_type == "STRING":
        out["text"] = message.string
    if message.message_type == "IMAGE":
        out["shape"] = list(message.image.shape)
        out["sum"] = int(message.image.astype(numpy.int64).sum())
    return out


def collect(peer):
    """Everything until the verdict of the last frame, and what follows it."""
    found, last, start = [], None, time.time()
    while time.time() - start < LIMIT_S and (last is None or time.time() - last < 0.5):
        for message in peer.get_latest_messages():
            found.append(told(message))
            if message.message_type == "STRING" and json.loads(message.string)["frame"] == LAST:
                last = time.time()
        time.sleep(0.002)
    print(json.dumps(found), flush=True)


def server():
    peer = pyigtl.OpenIGTLinkServer(port=0, local_server=True)
    print(peer.server_address[1], flush=True)
    return peer


def serve(folder):
    peer = server()
    wait(peer.is_connected)
    for path in sorted(Path(folder).iterdir()):
        width, height = map(int, path.suffix[1:].split("x"))
        image = numpy.fromfile(path, numpy.uint8).reshape(1, height, width, 3)
        peer.send_message(pyigtl.StringMessage("not a picture", device_name="Video"), wait=True)
        peer.send_message(pyigtl.ImageMessage(image[:, :4], device_name="Other"), wait=True)
        peer.send_message(pyigtl.ImageMessage(image, device_name="Video"), wait=True)
    time.sleep(0.5)


if __name__ == "__main__":
    if sys.argv[1] == "serve":
        serve(sys.argv[2])
    elif sys.argv[1] == "listen":
        host, port = sys.argv[2].split(":")
        collect(pyigtl.OpenIGTLinkClient(host, int(port)))
    else:
        collect(server())
    # Its threads do not end by themselves.
    os._exit(0)
