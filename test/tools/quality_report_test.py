#!/usr/bin/python3
"""Figures, colours and the page of scripts/quality_report.py.

usage: quality_report_test.py SOURCE_FOLDER"""
import json
import os
import sys
import tempfile
import unittest

SOURCE = os.path.abspath(sys.argv.pop(1))
sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(SOURCE, "scripts"))
import numpy as np
from PIL import Image
import quality_figures as figures
import quality_report


def mean_of_first(confidence, loss, n):
    """Mean loss of the n most confident, averaged over all orders of equal confidences: expected values."""
    limit = sorted(confidence, reverse=True)[n - 1]
    above = [x for c, x in zip(confidence, loss) if c > limit]
    equal = [x for c, x in zip(confidence, loss) if c == limit]
    return (sum(above) + (n - len(above)) * sum(equal) / len(equal)) / n


class Confidence(unittest.TestCase):
    def test_agrees_with_brute_force_also_where_confidences_are_equal(self):
        random = np.random.RandomState(1)
        confidence = random.randint(0, 6, 60) / 5.0
        for loss in (random.rand(60), (random.rand(60) < 0.3).astype(float)):
            risk, ideal = figures.risk_coverage(confidence, loss)
            expected = [mean_of_first(list(confidence), list(loss), n) for n in range(1, 61)]
            best = [sum(sorted(loss)[:n]) / n for n in range(1, 61)]
            np.testing.assert_allclose(risk, expected, atol=1e-12)
            np.testing.assert_allclose(ideal, best, atol=1e-12)
            self.assertAlmostEqual(figures.area_ratio(risk, ideal), sum(expected) / sum(best), 9)

    def test_ratio_is_one_for_a_perfect_order(self):
        loss = np.array([0.4, 0.1, 0.2, 0.9])
        self.assertAlmostEqual(figures.area_ratio(*figures.risk_coverage(-loss, loss)), 1.0)
        self.assertGreater(figures.area_ratio(*figures.risk_coverage(loss, loss)), 1.5)

    def test_ratio_is_undefined_without_errors_or_pixels(self):
        self.assertTrue(np.isnan(figures.area_ratio(*figures.risk_coverage([0.1, 0.2], [0.0, 0.0]))))
        self.assertTrue(np.isnan(figures.area_ratio(*figures.risk_coverage([], []))))


class Pictures(unittest.TestCase):
    def test_colours_say_sign_and_size_of_the_error(self):
        truth = np.array([[0, 2, 2, 2, 2, 2, 2, 2]], float)
        estimate = np.array([[2, 0, 2, 2.019, 1.0, 3.0, 1.95, 2.1]])
        picture = figures.error_picture(estimate, truth)[0].astype(int)
        self.assertEqual(picture[0].tolist(), [0, 0, 0])
        self.assertEqual(picture[1].tolist(), figures.NO_ESTIMATE.tolist())
        self.assertEqual(picture[2].tolist(), figures.GREY.tolist())
        self.assertEqual(picture[3].tolist(), figures.GREY.tolist())
        self.assertEqual(picture[4].tolist(), figures.NEAR.tolist())
        self.assertEqual(picture[5].tolist(), figures.FAR.tolist())
        self.assertGreater(picture[6][2], picture[6][0])  # blue, but paler
        self.assertGreater(picture[6][0], picture[4][0])
        self.assertGreater(picture[7][0], picture[7][2])

    def test_sparse_truth_becomes_squares_and_dense_truth_stays(self):
        known = np.zeros((20, 30), bool)
        known[10, 0] = True
        picture = np.where(known[..., None], 200, np.zeros(3, int))
        self.assertEqual(int((figures.spread_sparse(picture, known)[..., 0] > 0).sum()), 5 * 3)  # cut at the border
        self.assertEqual(int((figures.spread_sparse(picture, known | True)[..., 0] > 0).sum()), 1)

    def test_nearest_keeps_pixels_of_thinned_maps(self):
        full = np.arange(12 * 15).reshape(12, 15)
        np.testing.assert_array_equal(figures.nearest(full, 4, 5), full[1::3, 1::3])
        np.testing.assert_array_equal(figures.nearest(full, 12, 15), full)

    def test_no_pixel_of_sparse_truth_is_lost(self):
        truth = np.zeros((40, 60))
        truth[[0, 7, 39], [0, 33, 59]] = [1, 2, 3]
        small = figures.truth_at(truth, 10, 20)
        self.assertEqual([small[0, 0], small[1, 11], small[9, 19], np.count_nonzero(small)], [1, 2, 3, 3])
        dense = np.arange(1, 2401).reshape(40, 60)
        np.testing.assert_array_equal(figures.truth_at(dense, 10, 20), figures.nearest(dense, 10, 20))


class Report(unittest.TestCase):
    def setUp(self):
        self.root = tempfile.TemporaryDirectory()
        self.results, self.scenes = (os.path.join(self.root.name, name) for name in ("results", "scenes"))
        for folder in ("depth", "images"):
            os.makedirs(os.path.join(self.scenes, "a<b", folder))
        scene = os.path.join(self.scenes, "a<b")
        with open(os.path.join(scene, "cameras.txt"), "w") as file:
            file.write("# header\n3 c.png 1 1\n")
        Image.fromarray(np.full((8, 10, 3), 90, np.uint8)).save(os.path.join(scene, "images/c.png"))
        Image.fromarray(np.full((8, 10), 2000, np.uint16)).save(os.path.join(scene, "depth/000003.png"))
        for preset, depth in (("acmh", 2100), ("acmp", 2010)):
            self.write_result(os.path.join(self.results, "a<b", preset), depth)

    def tearDown(self):
        self.root.cleanup()

    def write_result(self, folder, depth):
        os.makedirs(os.path.join(folder, "maps"))
        mean = [10.0, 20.0, 30.0, 40.0, 50.0, depth / 40.0, 100.0, None]
        row = {"threshold": 0.05, "accuracy": 81.25, "completeness": 41.5, "f1": 55.0}
        for name, content in (("depth", {"mean": mean, "regions": []}), ("cloud", {"metrics": [row]}),
                              ("summary", {"images_matched_in_last_run": 4,
                                           "milliseconds_in_last_run": {"whole run (steps overlap)": 10}})):
            with open(os.path.join(folder, name + ".json"), "w") as file:
                json.dump(content, file)
        Image.fromarray(np.full((8, 10), depth, np.uint16)).save(os.path.join(folder, "maps/000003_depth.png"))
        Image.fromarray(np.full((8, 10), 128, np.uint8)).save(os.path.join(folder, "maps/000003_confidence.png"))

    def run_main(self, *options):
        output = os.path.join(self.root.name, "report.html")
        sys.argv = ["quality_report.py", self.results, self.scenes, output] + list(options)
        code = quality_report.main()
        if code != 0:
            return code, ""
        with open(output) as file:
            return code, file.read()

    def test_page_has_figures_pictures_and_references_and_nothing_outside(self):
        reference = os.path.join(self.root.name, "reference.csv")
        with open(reference, "w") as file:
            file.write("scene,name\na<b,public,1,2.25,3,4,5,6\n")
        code, page = self.run_main("--reference", reference)
        self.assertEqual(code, 0)
        for text in ("a&lt;b", "accuracy at 5 cm", "81.2", "2.5", "public", "52.5", "acmp: 100.0 % &lt; 5 cm"):
            self.assertIn(text, page)
        self.assertNotIn("a<b", page)
        self.assertNotIn("http", page)
        self.assertGreaterEqual(page.count("data:image/"), 7)

    def test_bad_input_is_named(self):
        reference = os.path.join(self.root.name, "reference.csv")
        with open(reference, "w") as file:
            file.write("a,public,1,2\n")
        self.assertEqual(self.run_main("--reference", reference)[0], 2)
        self.assertEqual(self.run_main("--gt-png-unit", "0")[0], 2)
        self.results = self.scenes
        self.assertEqual(self.run_main()[0], 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
