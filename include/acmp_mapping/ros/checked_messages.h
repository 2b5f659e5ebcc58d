#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

#include <ros/node_handle.h>
#include <ros/serialization.h>
#include <rosbag/message_instance.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"

/// roscpp takes memory for as many elements as a message claims to have before it looks how many bytes there are: 44
/// bytes may cost gigabytes.
namespace acmp {

/// Goes through a serialized message with the code that reads it, and reads its lengths only.
class LengthStream {
 public:
  LengthStream(const uint8_t* data, size_t bytes) : next_(data), left_(bytes) {}

  /// Of a field, or of a message. Throws InvalidInputError when it ends beyond the bytes.
  template <class T>
  void next(T& field) {
    if constexpr (std::is_arithmetic_v<T>) {
      Skip(1, sizeof(T));
    } else {
      ros::serialization::Serializer<T>::template allInOne<LengthStream, T&>(*this, field);
    }
  }
  void next(ros::Time& /*field*/) { Skip(2, sizeof(uint32_t)); }
  void next(ros::Duration& /*field*/) { Skip(2, sizeof(uint32_t)); }
  void next(std::string& /*field*/) { Skip(Length(), 1); }
  template <class T>
  void next(std::vector<T>& /*field*/) {
    const uint32_t length = Length();
    if constexpr (std::is_arithmetic_v<T>) {
      Skip(length, sizeof(T));
    } else {
      T element;
      for (uint32_t i = 0; i < length; ++i) next(element);
    }
  }
  template <class T, size_t N>
  void next(boost::array<T, N>& field) {
    for (T& element : field) next(element);
  }

 private:
  uint32_t Length() {
    const uint8_t* const at = next_;
    Skip(1, sizeof(uint32_t));
    uint32_t length;
    std::memcpy(&length, at, sizeof(length));
    return length;
  }
  void Skip(uint64_t count, uint64_t bytes_each) {
    if (count * bytes_each > left_) {
      throw InvalidInputError(
          Concat("a message claims ", count, " elements of ", bytes_each, " bytes, where ", left_, " bytes are left"));
    }
    next_ += count * bytes_each;
    left_ -= count * bytes_each;
  }

  const uint8_t* next_;
  size_t left_;
};

/// Throws InvalidInputError when a serialized message claims more than there is.
template <class Message>
void CheckLengths(const uint8_t* data, size_t bytes) {
  Message message;
  LengthStream(data, bytes).next(message);
}

/// As NodeHandle::subscribe, with CheckLengths before memory is taken; roscpp logs what that throws.
template <class Message, class Callback>
ros::Subscriber SubscribeChecked(ros::NodeHandle nh, const std::string& topic, uint32_t queue, const Callback& call,
                                 const ros::TransportHints& hints = ros::TransportHints()) {
  using Parameter = const boost::shared_ptr<const Message>&;
  const boost::function<void(Parameter)> callback = call;
  struct Helper : ros::SubscriptionCallbackHelperT<Parameter> {
    using ros::SubscriptionCallbackHelperT<Parameter>::SubscriptionCallbackHelperT;
    ros::VoidConstPtr deserialize(const ros::SubscriptionCallbackHelperDeserializeParams& params) override {
      CheckLengths<Message>(params.buffer, params.length);
      return ros::SubscriptionCallbackHelperT<Parameter>::deserialize(params);
    }
  };
  ros::SubscribeOptions options;
  options.initByFullCallbackType<Parameter>(topic, queue, callback);
  options.helper = boost::make_shared<Helper>(callback);
  options.transport_hints = hints;
  return nh.subscribe(options);
}

/// As record.instantiate(), with CheckLengths: null for another type, or another definition of it.
template <class Message>
boost::shared_ptr<Message> InstantiateChecked(const rosbag::MessageInstance& record) {
  if (!record.isType<Message>()) return nullptr;
  std::vector<uint8_t> bytes(record.size());
  ros::serialization::OStream into(bytes.data(), static_cast<uint32_t>(bytes.size()));
  record.write(into);
  CheckLengths<Message>(bytes.data(), bytes.size());
  auto message = boost::make_shared<Message>();
  ros::serialization::IStream from(bytes.data(), static_cast<uint32_t>(bytes.size()));
  ros::serialization::deserialize(from, *message);
  return message;
}

}  // namespace acmp
