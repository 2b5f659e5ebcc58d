#include "acmp_mapping/map/find_transform.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <random>
#include <set>
#include <tuple>
#include <vector>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/mesh/splat_points.h"

namespace acmp {
namespace {

constexpr double kOnSurface = 0.02;    ///< relative: as fusion lets views agree
constexpr size_t kFewestTogether = 8;  ///< matches of two images that give a similarity
constexpr size_t kFewestOfAll = 40;    ///< matches of all images
constexpr double kClearlyMost = 2;     ///< times as many as support any other place
constexpr size_t kMaxPlaces = 30;      ///< that are compared
constexpr double kScaleTolerance = 1.05;
constexpr double kFewestOverlapping = 0.05;  ///< of the session's points
constexpr double kFewestAgreeing = 0.7;      ///< of those that overlap

/// What a keyframe's points look like, and what stands out in that.
struct RegisteredView {
  SurfaceMaps maps;
  cv::Mat descriptors;
  std::vector<Eigen::Vector3d> points;  ///< one per descriptor, world
  std::vector<double> tolerances;       ///< of their places
};

struct PointMatch {
  Eigen::Vector3d in_session, in_map;
  double tolerance;
};

RegisteredView MakeRegisteredView(const SessionKeyframe& keyframe, double voxel_size) {
  RegisteredView view;
  const PointCloud points = keyframe.points_in_camera->Unpack();
  if (points.empty()) return view;
  view.maps = SplatPoints(points, keyframe.pose.world_from_cam(), PointSpacing(points, voxel_size));
  const ColorImage& color = view.maps.color;
  constexpr int kPatchSize = 31;  // px: ORB throws for images that hold none
  if (std::min(color.width(), color.height()) < kPatchSize) return view;
  cv::Mat gray, known(color.height(), color.width(), CV_8U);
  cv::cvtColor(cv::Mat(color.height(), color.width(), CV_8UC3, const_cast<Rgb*>(color.data())), gray,
               cv::COLOR_RGB2GRAY);
  for (int row = 0; row < known.rows; ++row) {
    for (int col = 0; col < known.cols; ++col) known.at<uint8_t>(row, col) = view.maps.depth(col, row) > 0 ? 255 : 0;
  }
  // What is unknown would stand out.
  constexpr int kPatch = 15;  // px: half of what describes a corner
  cv::Mat inside;
  cv::morphologyEx(known, inside, cv::MORPH_CLOSE, cv::Mat::ones(5, 5, CV_8U));
  cv::Mat filled;
  cv::dilate(gray, filled, cv::Mat::ones(5, 5, CV_8U));
  filled.copyTo(gray, known == 0);
  cv::erode(inside, inside, cv::Mat::ones(kPatch, kPatch, CV_8U));
  std::vector<cv::KeyPoint> corners;
  const cv::Ptr<cv::ORB> orb = cv::ORB::create(500, 1.2f, 6, 15, 0, 2, cv::ORB::HARRIS_SCORE, kPatchSize, 10);
  orb->detectAndCompute(gray, inside & known, corners, view.descriptors);
  const PosedCamera& camera = view.maps.camera;
  cv::Mat kept;
  for (size_t i = 0; i < corners.size(); ++i) {
    const auto col = static_cast<int>(std::lround(corners[i].pt.x)),
               row = static_cast<int>(std::lround(corners[i].pt.y));
    const double depth = view.maps.depth(col, row);
    if (!(depth > 0)) continue;
    kept.push_back(view.descriptors.row(static_cast<int>(i)));
    view.points.push_back(camera.cam_from_world.inverse() *
                          camera.camera.Unproject({corners[i].pt.x, corners[i].pt.y}, depth));
    view.tolerances.push_back(kOnSurface * depth + voxel_size);
  }
  view.descriptors = kept;
  return view;
}

/// Keyframes of which each is as far as can be from those before, with what it looks at: a place counts once, however
/// often it was seen.
std::vector<size_t> SpreadOut(const std::vector<SessionKeyframe>& keyframes) {
  using Place = Eigen::Matrix<double, 6, 1>;  // of the camera and the middle of its points
  std::vector<Place> places;
  for (const SessionKeyframe& keyframe : keyframes) {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    const PointCloud points = keyframe.points_in_camera->Unpack();
    for (const SurfacePoint& p : points) middle += Eigen::Vector3d(p.position.x, p.position.y, p.position.z);
    middle = keyframe.pose.world_from_cam() * (middle / static_cast<double>(std::max<size_t>(1, points.size())));
    places.emplace_back();
    places.back() << keyframe.pose.world_from_cam().translation(), middle;
  }
  std::vector<size_t> chosen;
  std::vector<double> distances(places.size(), std::numeric_limits<double>::infinity());  // from those chosen
  while (chosen.size() < std::min(places.size(), kMaxRegistered)) {
    const auto farthest = std::max_element(distances.begin(), distances.end());
    chosen.push_back(static_cast<size_t>(farthest - distances.begin()));
    for (size_t i = 0; i < places.size(); ++i) {
      distances[i] = std::min(distances[i], (places[i] - places[chosen.back()]).norm());
    }
    distances[chosen.back()] = -1;
  }
  return chosen;
}

std::vector<RegisteredView> MakeRegisteredViews(const MapSession& session) {
  const std::vector<size_t> chosen = SpreadOut(session.keyframes);
  std::vector<RegisteredView> views(chosen.size());
  tbb::parallel_for(size_t{0}, chosen.size(),
                    [&](size_t i) { views[i] = MakeRegisteredView(session.keyframes[chosen[i]], session.voxel_size); });
  return views;
}

std::vector<PointMatch> MatchViews(const RegisteredView& session, const RegisteredView& map) {
  constexpr float kUnique = 0.8f;  // Lowe's ratio
  std::vector<PointMatch> matches;
  if (session.descriptors.rows < 2 || map.descriptors.rows < 2) return matches;
  std::vector<std::vector<cv::DMatch>> candidates;
  cv::BFMatcher(cv::NORM_HAMMING).knnMatch(session.descriptors, map.descriptors, candidates, 2);
  for (const std::vector<cv::DMatch>& nearest : candidates) {
    if (nearest[0].distance > kUnique * nearest[1].distance) continue;
    const auto i = static_cast<size_t>(nearest[0].queryIdx), j = static_cast<size_t>(nearest[0].trainIdx);
    matches.push_back({session.points[i], map.points[j], session.tolerances[i] + map.tolerances[j]});
  }
  return matches;
}

/// Umeyama's, of these matches.
Eigen::Affine3d SimilarityOf(const std::vector<PointMatch>& matches) {
  Eigen::Matrix3Xd from(3, matches.size()), to(3, matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) = matches[i].in_session;
    to.col(static_cast<Eigen::Index>(i)) = matches[i].in_map;
  }
  return Eigen::Affine3d(Eigen::umeyama(from, to, true));
}

double ScaleIn(const Eigen::Affine3d& similarity) { return std::cbrt(similarity.linear().determinant()); }

/// @param strictness by what tolerances are divided
std::vector<PointMatch> Supporting(const std::vector<PointMatch>& matches, const Eigen::Affine3d& similarity,
                                   double strictness = 1) {
  std::vector<PointMatch> supporting;
  for (const PointMatch& match : matches) {
    if ((similarity * match.in_session - match.in_map).norm() * strictness < match.tolerance)
      supporting.push_back(match);
  }
  return supporting;
}

/// Of two images; with too little support none.
std::vector<PointMatch> Consensus(const std::vector<PointMatch>& matches) {
  constexpr int kDraws = 300;
  std::vector<PointMatch> best;
  if (matches.size() < kFewestTogether) return {};
  std::minstd_rand random(1);
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<PointMatch> three(3);
    for (PointMatch& match : three) match = matches[random() % matches.size()];
    const Eigen::Affine3d similarity = SimilarityOf(three);
    const double scale = ScaleIn(similarity);
    if (!(scale > 0.1 && scale < 10)) continue;
    std::vector<PointMatch> supporting = Supporting(matches, similarity);
    if (supporting.size() > best.size()) best = std::move(supporting);
  }
  if (best.size() < kFewestTogether) best.clear();
  return best;
}

/// A place where the session may lie.
struct SessionPlace {
  Eigen::Affine3d map_from_session;
  std::vector<PointMatch> matches;  ///< that support it
};

/// One match of each place in the map: what many images show is no more than one thing.
std::vector<PointMatch> OneOfEachPlace(const std::vector<PointMatch>& matches) {
  std::vector<PointMatch> kept;
  std::set<std::tuple<int64_t, int64_t, int64_t>> taken;
  for (const PointMatch& match : matches) {
    const auto cell = [&](int axis) { return static_cast<int64_t>(std::floor(match.in_map[axis] / match.tolerance)); };
    if (taken.emplace(cell(0), cell(1), cell(2)).second) kept.push_back(match);
  }
  return kept;
}

SessionPlace RefinePlace(const std::vector<PointMatch>& all, Eigen::Affine3d similarity) {
  SessionPlace place;
  for (int i = 0; i < 5; ++i) {
    place = {similarity, OneOfEachPlace(Supporting(all, similarity))};
    if (place.matches.size() < 3) break;
    similarity = SimilarityOf(place.matches);
  }
  return place;
}

/// All places that matches of two images support, those with the most support first.
std::vector<SessionPlace> FindPlaces(std::vector<std::vector<PointMatch>> of_pairs) {
  std::vector<PointMatch> all;
  for (const std::vector<PointMatch>& matches : of_pairs) all.insert(all.end(), matches.begin(), matches.end());
  std::stable_sort(of_pairs.begin(), of_pairs.end(), [](const auto& a, const auto& b) { return a.size() > b.size(); });
  std::vector<SessionPlace> places;
  for (const std::vector<PointMatch>& matches : of_pairs) {
    const auto is_known = [&](const SessionPlace& place) {
      return 2 * Supporting(matches, place.map_from_session).size() > matches.size();
    };
    if (matches.empty() || std::any_of(places.begin(), places.end(), is_known)) continue;
    places.push_back(RefinePlace(all, SimilarityOf(matches)));
  }
  std::stable_sort(places.begin(), places.end(),
                   [](const SessionPlace& a, const SessionPlace& b) { return a.matches.size() > b.matches.size(); });
  return places;
}

/// By the matches that fit best.
void Polish(SessionPlace* place) {
  for (const double strictness : {2, 4}) {
    const std::vector<PointMatch> strict = Supporting(place->matches, place->map_from_session, strictness);
    if (strict.size() < kFewestOfAll) return;
    *place = {SimilarityOf(strict), strict};
  }
}

/// Without its scale; none where that is not 1.
std::optional<RigidTransform> RigidTransformOf(const SessionPlace& place) {
  const double scale = ScaleIn(place.map_from_session);
  if (!(scale < kScaleTolerance && scale * kScaleTolerance > 1)) return std::nullopt;
  RigidTransform rigid = RigidTransform::Identity();
  rigid.linear() = place.map_from_session.linear() / scale;
  Eigen::Vector3d from = Eigen::Vector3d::Zero(), to = Eigen::Vector3d::Zero();
  for (const PointMatch& match : place.matches) from += match.in_session, to += match.in_map;
  rigid.translation() = (to - rigid.linear() * from) / static_cast<double>(place.matches.size());
  return rigid;
}

/// Of the session's points those that the map's cameras looked at, and how many of them lie on what they saw.
FoundTransform CountAgreeing(const MapSession& session, const std::vector<RegisteredView>& map,
                             const RigidTransform& map_from_session, size_t matches) {
  size_t agreeing = 0, all = 0, overlap = 0;
  for (const SessionKeyframe& keyframe : session.keyframes) {
    const RigidTransform map_from_cam = map_from_session * keyframe.pose.world_from_cam();
    const size_t step = 1 + keyframe.points_in_camera->size() / 2000;
    for (size_t i = 0; i < keyframe.points_in_camera->size(); i += step) {
      const Vec3f p = (*keyframe.points_in_camera)[i].position;
      const Eigen::Vector3d point = map_from_cam * Eigen::Vector3d(p.x, p.y, p.z);
      bool is_seen = false, is_on_surface = false;
      for (const RegisteredView& view : map) {
        if (view.maps.depth.empty()) continue;
        const Eigen::Vector3d in_view = view.maps.camera.cam_from_world * point;
        const auto pixel = view.maps.camera.camera.PixelOf(in_view);
        const double depth = pixel ? view.maps.depth(pixel->x(), pixel->y()) : 0;
        if (!(depth > 0) || in_view.z() > (1 + 2 * kOnSurface) * depth) continue;  // hidden from it
        is_seen = true;
        is_on_surface = is_on_surface || in_view.z() > (1 - 2 * kOnSurface) * depth;
      }
      ++all, overlap += is_seen, agreeing += is_on_surface;
    }
  }
  return {map_from_session, matches, static_cast<double>(overlap) / static_cast<double>(std::max<size_t>(1, all)),
          static_cast<double>(agreeing) / static_cast<double>(std::max<size_t>(1, overlap))};
}

bool Agrees(const FoundTransform& found) {
  return found.overlap >= kFewestOverlapping && found.agreement >= kFewestAgreeing;
}

}  // namespace

FoundTransform FindTransform(const MapSession& map, const MapSession& session, const std::function<void()>& check) {
  const std::vector<RegisteredView> map_views = MakeRegisteredViews(map), views = MakeRegisteredViews(session);
  std::vector<std::vector<PointMatch>> of_pairs(views.size() * map_views.size());
  tbb::parallel_for(size_t{0}, of_pairs.size(), [&](size_t i) {
    check();
    of_pairs[i] = Consensus(MatchViews(views[i / map_views.size()], map_views[i % map_views.size()]));
  });
  std::vector<SessionPlace> places = FindPlaces(std::move(of_pairs));
  FoundTransform found;
  found.matches = places.empty() ? 0 : places[0].matches.size();
  if (found.matches < kFewestOfAll) {
    throw InvalidInputError(
        Concat("no place was found: at most ", found.matches, " matches support one, must be at least ", kFewestOfAll));
  }
  if (places.size() > 1 && static_cast<double>(places[1].matches.size()) * kClearlyMost > found.matches) {
    throw InvalidInputError(Concat("it may lie at more than one place: ", found.matches, " matches support one, and ",
                                   places[1].matches.size(), " another"));
  }
  SessionPlace& best = places[0];
  Polish(&best);
  const std::optional<RigidTransform> map_from_session = RigidTransformOf(best);
  if (!map_from_session) {
    throw InvalidInputError(
        Concat("the map is ", ScaleIn(best.map_from_session), " times as large: must be of the same scale"));
  }
  found = CountAgreeing(session, map_views, *map_from_session, best.matches.size());
  const auto percent = [](double share) { return std::lround(100 * share); };
  if (!Agrees(found)) {
    throw InvalidInputError(Concat("where ", found.matches, " matches put it ", percent(found.overlap),
                                   " % of its points lie in view of the map's cameras, and ", percent(found.agreement),
                                   " % of these on its surfaces: must be at least ", percent(kFewestOverlapping),
                                   " and ", percent(kFewestAgreeing), " %"));
  }
  // Where fewer matches put it, as that place was seen less, it may fit as well.
  for (size_t i = 1; i < std::min(places.size(), kMaxPlaces); ++i) {
    check();
    constexpr double kSamePlace = 3;  // tolerances
    if (2 * Supporting(best.matches, places[i].map_from_session, 1 / kSamePlace).size() > best.matches.size()) continue;
    const std::optional<RigidTransform> other_place = RigidTransformOf(places[i]);
    if (!other_place) continue;
    const FoundTransform other = CountAgreeing(session, map_views, *other_place, places[i].matches.size());
    if (!Agrees(other)) continue;
    throw InvalidInputError(Concat("it may lie at more than one place: of its points in view of the map's cameras ",
                                   percent(found.agreement), " % lie on surfaces at one, and ",
                                   percent(other.agreement), " % at another"));
  }
  return found;
}

}  // namespace acmp
