"""Teams of servicers in a scenario: the scenario of each alone, checks, and static settings"""
