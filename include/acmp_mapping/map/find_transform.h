#pragma once

#include <functional>

#include "acmp_mapping/map/map_store.h"

namespace acmp {

constexpr size_t kMaxRegistered = 40;  ///< keyframes of a map

/// Where a session lies in a map.
struct FoundTransform {
  RigidTransform map_from_session = RigidTransform::Identity();
  size_t matches = 0;    ///< places at which points that look alike come to lie together
  double overlap = 0;    ///< share of the session's points that the map's cameras looked at
  double agreement = 0;  ///< share of these that lie on the map's surfaces, and not before them
};

/// Finds it from the images that the points give (SplatPoints): what looks alike (ORB) in an image of either, with its
/// place in space, gives a similarity (RANSAC, Umeyama 1991); the one that most matches of all images support is
/// refined by them. A place of the map counts once, however many images show it. Takes about a second per hundred pairs
/// of keyframes; of each side at most kMaxRegistered, spread over what they show, are used.
///
/// Throws InvalidInputError that says why where it is not sure: too few matches, another place that half as many
/// support or on whose surfaces its points lie, too, another scale, or points that do not agree.
/// @param check called before each pair of images, by any thread; what it throws ends the work
FoundTransform FindTransform(
    const MapSession& map, const MapSession& session, const std::function<void()>& check = [] {});

}  // namespace acmp
