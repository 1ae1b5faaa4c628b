# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium that looks at a page; what is missing for it skips the test."""

import shutil
from contextlib import contextmanager
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.image import imread

_QUIET = ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
          '--disable-component-update', '--disable-sync']
_WEBGL = ['--use-angle=swiftshader', '--enable-unsafe-swiftshader']
_LOADED = 60_000  # ms
HARMLESS = ('THREE.Clock',)  # of viser's own page


class Look:
    """A page that is open in the browser.

    Attributes:
        page: playwright's Page
        complaints: texts of errors and warnings on its console, and of what did not load
    """

    def __init__(self, page):
        self.page, self.complaints = page, []
        page.on('console', lambda message: self._note(message.type, message.text))
        page.on('pageerror', lambda error: self.complaints.append(str(error)))
        page.on('requestfailed', lambda request: self.complaints.append(request.url))

    def _note(self, kind, text):
        if kind in ('error', 'warning') and not any(word in text for word in HARMLESS):
            self.complaints.append(text)

    def wait_for(self, text):
        """Wait until the page says so."""
        self.page.get_by_text(text).first.wait_for(timeout=_LOADED)

    def picture(self):
        """Return the pixels (h, w, 3) of the scene, left of the panel, without notices."""
        size = self.page.viewport_size
        shot = self.page.screenshot(clip={'x': 0, 'y': 160, 'width': size['width'] * 0.5,
                                          'height': size['height'] - 160})
        return imread(BytesIO(shot))[:, :, :3]

    def changed(self, before, seconds=30.0):
        """Return the part of the pixels that differ from `before`, once some do."""
        for _ in range(int(seconds / 0.25)):
            part = np.mean(np.abs(self.picture() - before).max(axis=2) > 0.05)
            if part > 0:
                return part
            self.page.wait_for_timeout(250)
        return 0.0

    def colors(self):
        """Return how many pixels are colored, which the grid, texts and walls are not."""
        picture = self.picture()
        return int((np.ptp(picture, axis=2) > 0.3).sum())


@contextmanager
def looking_at(url):
    """Yield a Look at a page."""
    playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
    chromium = shutil.which('chromium') or shutil.which('chromium-browser')
    if chromium is None:
        pytest.skip('there is no chromium')
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=[*_QUIET, *_WEBGL])
        try:
            look = Look(browser.new_page(viewport={'width': 900, 'height': 560}))
            look.page.goto(url)
            look.page.wait_for_selector('canvas', timeout=_LOADED)
            yield look
        finally:
            browser.close()


def dragged_to(handle, pose):
    """Do with a handle of viser what it does when somebody drags it."""
    handle.position, handle.wxyz = pose.position, np.roll(pose.quaternion, 1)
    for callback in list(handle._impl_aux.update_cb):
        callback(SimpleNamespace(target=handle, phase='update', client=None))
