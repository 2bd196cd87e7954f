"""The board's end of the link: who may connect, and which frames each client is sent (backpressure by window)."""
