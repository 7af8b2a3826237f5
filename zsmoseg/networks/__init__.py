"""Networks: a model is ONNX graphs beside a contract that says what goes in and what comes out."""
