"""The recorder: publishes submissions, events, heartbeats and a signed manifest of what it received.

One core for ROS 1 and ROS 2, in Python 2.7 and 3: `attest`, `minisign`, `plan`, `watch`, `session` and
`forwarding` import nothing of ROS. `ros1` and `ros2` are the nodes around it.
"""
