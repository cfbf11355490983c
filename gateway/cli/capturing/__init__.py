"""What ``pitch-gateway capture`` makes of the frames of a line."""
