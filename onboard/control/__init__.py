"""Control of a running daemon: requests over a Unix socket and over the link, and key management."""
