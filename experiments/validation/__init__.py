"""Does the plant agree with Basilisk, an independent simulator, on the same problems?"""
