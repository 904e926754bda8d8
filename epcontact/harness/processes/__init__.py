"""Processes that call functions for this one, and executors that spread calls over them.

child             a process that can be ended at any moment
template          a process of which others are copies
pool              calls spread over an executor
threads           libraries that are loaded without threads of their own
"""
