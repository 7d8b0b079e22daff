"""The compiled step of the firmware and its memory: frames in, one epoch, frames out."""
