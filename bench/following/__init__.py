"""Judge the parts of following one by one."""
