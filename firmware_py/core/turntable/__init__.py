"""Commands the turntable and reads its encoders."""
