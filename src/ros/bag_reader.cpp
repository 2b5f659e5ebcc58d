#include "acmp_mapping/ros/bag_reader.h"

#include "acmp_mapping/common/error.h"
#include "bag_records.h"

namespace acmp {

void ReadBag(const std::filesystem::path& path, const char* when_cut_off,
             const std::function<void(const rosbag::Bag&)>& read, size_t max_chunk_bytes) {
  if (!std::filesystem::is_regular_file(path)) throw InvalidInputError(Concat(path, ": no such file"));
  bool opened = false;
  try {
    CheckBagRecords(path, max_chunk_bytes);
    const rosbag::Bag bag(path.string(), rosbag::bagmode::Read);
    opened = true;
    read(bag);
  } catch (const rosbag::BagUnindexedException&) {
    throw InvalidInputError(Concat(path, ": has no index, so it was cut off; ", when_cut_off));
  } catch (const std::exception& error) {  // rosbag's, and out of memory or range from corrupt lengths
    if (opened && dynamic_cast<const InvalidInputError*>(&error)) throw;
    throw InvalidInputError(Concat(path, ": is truncated, corrupt or not a bag: ", error.what()));
  }
}

}  // namespace acmp
