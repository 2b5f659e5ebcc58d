#pragma once

#include <cstdint>

namespace acmp {

constexpr int kMaxSourceViews = 32;  ///< the selected-view mask is one 32-bit word

/// Whose method the passes follow. The papers' compute what the papers describe and nothing else.
enum class Method {
  kOurs,  ///< ACMP, faster and better on most scenes; docs/algorithm.md lists what differs
  kAcmh,  ///< Xu and Tao, CVPR 2019: "Multi-Scale Geometric Consistency Guided Multi-View Stereo", section 3
  kAcmp,  ///< Xu and Tao, AAAI 2020; its photometric pass is ACMH's, as the paper says
};

/// Parameters of one PatchMatch pass. Defaults are the paper's where nothing else is said. Bounds are those of the
/// kernels: what a user can set is checked by the table of options, the rest is a preset's.
struct PatchMatchOptions {
  Method method = Method::kOurs;
  int photometric_iterations = 3;   ///< T_photo, 1..20
  int planar_prior_iterations = 2;  ///< T_p-photo, 1..20; the paper has 3
  int geometric_iterations = 1;     ///< T_geo, 1..20; the paper has 2
  uint32_t seed = 1;                ///< of the counter-based random numbers

  float sigma_spatial_px = 5.0f;  ///< bilateral weight exp(-r / (2 s^2)), > 0
  float sigma_color = 3.0f;       ///< bilateral weight exp(-|dI| / (2 s^2)), grey levels, > 0

  /// In place of sigma_color where the estimate's surface bends or breaks within the window, grey levels, > 0: what is
  /// nearer or farther there has to differ less to be left out. In passes that start from an estimate, ours alone.
  float edge_sigma_color = 1.5f;
  /// The surface does so where the inverse depths of two pixels 5 px on either side sum up to more or less than twice
  /// the pixel's own by more than this fraction of it, > 0: a step by itself, a thin object by twice its step.
  float edge_bend = 0.03f;

  float min_variance = 0.01f;    ///< grey levels^2, > 0; a window below it has no texture. Relative to the reference's
                                 ///< centre value float32 keeps flat windows below it up to 100 grey levels of exposure
                                 ///< difference
  float sigma_view = 0.3f;       ///< sigma of the view likelihood (ACMP), beta of the confidence (ACMH)
  float view_smoothness = 0.9f;  ///< eta, 0.5..1
  int view_draws = 15;           ///< Monte-Carlo draws per pixel, 1..255; ACMH has none

  /// Passes that start from an estimate compare candidates only in the views that so many of the pixel and its four
  /// neighbours use, 0..5; 0: in all. Ours alone.
  int min_neighbours_per_view = 1;

  float perturb_depth = 0.02f;      ///< relative, (0, 1)
  float perturb_normal_deg = 1.8f;  ///< per axis, (0, 90)

  float prior_alpha = 0.18f;            ///< alpha of eq. 5, > 0
  float prior_gamma = 0.5f;             ///< gamma of eq. 6, > 0
  float prior_sigma_normal_deg = 5.0f;  ///< lambda_n of eq. 6; ours reads it as a standard deviation
  float prior_depth_divisor = 64.0f;    ///< lambda_d = depth interval / divisor; ours: a standard deviation
  float prior_start_cost = 0.1f;        ///< ours: pixels at or above start at the prior, 0..2

  float geometric_weight = 0.2f;  ///< lambda_geo of eq. 13, >= 0; ACMH's, ACMP has 0.1
  float geometric_max_px = 3.0f;  ///< tau_geo of eq. 13, > 0; ACMH's, ACMP has 5
};

}  // namespace acmp
