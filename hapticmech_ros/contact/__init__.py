# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Contacts of virtual objects: where shapes touch, and the forces there.

Imported only to run a scene with contacts.
"""
