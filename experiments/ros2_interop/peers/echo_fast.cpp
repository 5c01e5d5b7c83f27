// Sends back what comes, once a C++ object has been made of it and bytes again: Fast DDS. TYPE and SUPPORT name the type.
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <mutex>
#include "checkPubSubTypes.h"

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;

class Echo : public DataReaderListener {
public:
  DataWriter *writer = nullptr;
  std::atomic<int> left{0};
  std::mutex mutex;
  std::condition_variable done;

  void on_data_available(DataReader *reader) override
  {
    TYPE sample;
    SampleInfo info;
    while (reader->take_next_sample(&sample, &info) == ReturnCode_t::RETCODE_OK) {
      if (info.valid_data && writer->write(&sample) && --left == 0)
        done.notify_all();
    }
  }
};

int main(int argc, char **argv)
{
  if (argc != 3)
    return 1;
  Echo echo;
  echo.left = std::atoi(argv[2]);
  // Loopback alone, and the other side is told where to be: with its defaults Fast DDS does not find it.
  DomainParticipantQos participant_qos;
  auto transport = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  transport->interfaceWhiteList.push_back("127.0.0.1");
  participant_qos.transport().use_builtin_transports = false;
  participant_qos.transport().user_transports.push_back(transport);
  Locator_t peer;
  IPLocator::setIPv4(peer, "127.0.0.1");
  participant_qos.wire_protocol().builtin.initialPeersList.push_back(peer);
  auto *factory = DomainParticipantFactory::get_instance();
  DomainParticipant *participant = factory->create_participant(std::atoi(argv[1]), participant_qos);
  TypeSupport type(new SUPPORT());
  type.register_type(participant);
  Topic *there = participant->create_topic("rt/check/there", type.get_type_name(), TOPIC_QOS_DEFAULT);
  Topic *back = participant->create_topic("rt/check/back", type.get_type_name(), TOPIC_QOS_DEFAULT);
  DataWriterQos writer_qos;
  writer_qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  writer_qos.durability().kind = VOLATILE_DURABILITY_QOS;
  writer_qos.history().depth = 10;
  DataReaderQos reader_qos;
  reader_qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  reader_qos.history().depth = 10;
  echo.writer = participant->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(back, writer_qos);
  DataReader *reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(there, reader_qos, &echo);
  if (!echo.writer || !reader)
    return 1;
  std::unique_lock<std::mutex> lock(echo.mutex);
  const bool all = echo.done.wait_for(lock, std::chrono::seconds(120), [&] { return echo.left <= 0; });
  echo.writer->wait_for_acknowledgments({5, 0});
  return all ? 0 : 2;
}
