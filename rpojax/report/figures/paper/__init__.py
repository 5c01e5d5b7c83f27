"""The paper's figures of one run: bearing and range, estimation error, relative position."""
