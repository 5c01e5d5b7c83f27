"""Cooperation of several servicers: messages, and filters that share what each sees of the target."""
