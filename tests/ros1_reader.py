"""Reads messages with ROS 1's own definitions: run by the Python that has them, JSON in and out."""

import base64
import json
import sys
from importlib import import_module

answers = []
for package, name, raw in json.load(sys.stdin):
    kind = getattr(import_module(package + ".msg"), name)
    message = kind().deserialize(base64.b64decode(raw))
    answers.append({"md5": kind._md5sum, "text": str(message)})
json.dump(answers, sys.stdout)
