"""A client: one hello to the daemon; prints the answer."""

import json
import sys

import zmq

from common import session
from common.messages import SCHEMA_VERSION

context = zmq.Context()
socket = context.socket(zmq.DEALER)
socket.connect("tcp://127.0.0.1:5760")
socket.send(session.pack("hello", schema=SCHEMA_VERSION, client="probe"))
if not socket.poll(2000):
    sys.exit("no answer to hello within 2 s")
answer = session.unpack(socket.recv_multipart()[0])
socket.send(session.pack("bye"))
socket.close(linger=500)
context.term()
print(json.dumps(answer))
