"""Trained hand trackers: our own small one, and MediaPipe's two networks."""
