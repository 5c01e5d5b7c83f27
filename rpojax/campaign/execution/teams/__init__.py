"""Teams of servicers in a batch of runs: their values, free drifts from each other, and what is stored of them."""
