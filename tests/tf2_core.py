"""Asks tf2's own BufferCore: run by the Python that has it, JSON in and out."""

import json
import sys

import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped

asked = json.load(sys.stdin)
core = tf2_ros.BufferCore(rospy.Duration(100000))
for stamp_ns, parent, child, translation, quaternion, static in asked["transforms"]:
    one = TransformStamped()
    one.header.stamp = rospy.Time(*divmod(stamp_ns, 10**9))
    one.header.frame_id, one.child_frame_id = parent, child
    one.transform.translation.x, one.transform.translation.y, one.transform.translation.z = translation
    turned = one.transform.rotation
    turned.x, turned.y, turned.z, turned.w = quaternion
    (core.set_transform_static if static else core.set_transform)(one, "test")
answers = []
for fixed, frame, stamp_ns in asked["questions"]:
    try:
        found = core.lookup_transform_core(fixed, frame, rospy.Time(*divmod(stamp_ns, 10**9))).transform
        moved, turned = found.translation, found.rotation
        answers.append([[moved.x, moved.y, moved.z], [turned.x, turned.y, turned.z, turned.w]])
    except tf2_ros.TransformException:
        answers.append(None)
json.dump(answers, sys.stdout)
