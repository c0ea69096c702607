"""The process that holds the model: it reads prompts and writes answers under a grammar."""
