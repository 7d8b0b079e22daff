"""The CAN wire in virtual time, bit by bit, and the faults that can be injected on it."""
