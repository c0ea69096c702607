"""The parent side of the LLM: an asyncio engine over one worker process."""
