"""The verb `eval`: mission sets against models and variants, on this machine or on several."""
