#include "acmp_mapping/ros/bag_reader.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

void ReadBag(const std::filesystem::path& path, const char* when_cut_off,
             const std::function<void(const rosbag::Bag&)>& read) {
  if (!std::filesystem::is_regular_file(path)) throw InvalidInputError(Concat(path, ": no such file"));
  try {
    const rosbag::Bag bag(path.string(), rosbag::bagmode::Read);
    read(bag);
  } catch (const InvalidInputError&) {
    throw;
  } catch (const rosbag::BagUnindexedException&) {
    throw InvalidInputError(Concat(path, ": has no index, so it was cut off; ", when_cut_off));
  } catch (const std::exception& error) {  // rosbag's, and out of memory or range from corrupt lengths
    throw InvalidInputError(Concat(path, ": is truncated, corrupt or not a bag: ", error.what()));
  }
}

}  // namespace acmp
