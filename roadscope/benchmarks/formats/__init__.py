"""Readers and writers of files; `roadscope.formats` offers them to users."""
