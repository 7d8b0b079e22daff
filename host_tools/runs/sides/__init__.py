"""The two processes of a rehearsal: start, real time, the loop of each."""
