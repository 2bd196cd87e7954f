"""What the boat and the shore must agree on: messages, codec, link vocabulary, settings, time, angles."""
