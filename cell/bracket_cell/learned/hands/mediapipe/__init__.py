"""MediaPipe's palm and landmark networks without MediaPipe: converted once, run by onnxruntime."""
