"""What the boat and the shore share: messages, wire format, link protocol, settings, time, angles, events."""
