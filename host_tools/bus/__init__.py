"""The embedded virtual CAN bus: what the kernel's vcan would be, where the kernel has none.

One process hosts a channel, everyone else on the machine attaches to it through a Unix-domain
``SOCK_SEQPACKET`` socket. The bus is ordered (all see the same sequence), lossless (a slow node
makes the senders wait, nothing is dropped) and carries whole batches of frames in one datagram.

=============  ===================================================================
module         noun
=============  ===================================================================
`port`         a side's place on any python-can bus: frames by the epoch
`interface`    the python-can interface ``rrins`` and its batch face
`batch`        several frames at once, and what came with them
`message`      a frame on the wire as a `can.Message`, and back
`end`          what both ends of the bus can do
`link`         one attached end of the bus
`hub`          the hosting end; also a program of its own
`relay`        what goes from each peer to the others
`guard`        what a third party may do beside the two sides
`admission`    callers, until it is known who they are
`peer`         one attached process, as the hub sees it
`launch`       a hub process of its own, started when nobody hosts yet
`channel`      the place of a channel in the file system, and who holds it
`ownership`    whose a place is, and who is at the other end
`datagram`     the wire format
`pace`         how fast time passes on the bus
=============  ===================================================================

The host is not a thread: the bus moves while its host sends or receives, so a host that is stopped
in a debugger stops the world with it. Use ``host="auto"`` for a bus that lives on its own.
"""
