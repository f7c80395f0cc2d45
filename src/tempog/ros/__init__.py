"""What robots with ROS say: messages and transforms, without a ROS installation."""
