"""Films of recorded flights, drawn without a screen: MuJoCo draws, PyAV or Pillow encodes."""
