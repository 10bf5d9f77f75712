"""Contacts of virtual objects: where shapes touch, and the forces there.

Imported only by what runs a scene with contacts.
"""
