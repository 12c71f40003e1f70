"""The ground station: what would fly the real helicopter. Imports NumPy, ProxSuite and itself."""
