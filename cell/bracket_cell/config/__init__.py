"""Data only: the bench, the product, the gripper's CAN frames and a layout for viewers that come with the program."""
